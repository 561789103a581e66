"""What sensors can determine of a motion, proved exactly and said in words, and how well: see this folder's README."""
