"""Inputs that nobody should give: malformed and fuzzed files and arguments, through the command line."""
