"""Self-contained HTML pages: text, tables, pictures, a model to turn."""
