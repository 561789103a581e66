"""Initial estimates from the first epochs of a recording."""
