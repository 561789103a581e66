"""Commands of ``spinfilters``, one file each.

Nothing heavy is imported here, so that help is quick.
"""
