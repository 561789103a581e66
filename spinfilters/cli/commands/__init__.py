"""Commands of ``spinfilters``: one file each, in which nothing heavy is imported, so that help is quick."""
