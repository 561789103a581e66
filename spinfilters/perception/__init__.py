"""From tracks to poses."""
