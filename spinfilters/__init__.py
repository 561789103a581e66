"""spinfilters: how does that unknown object spin?"""

__version__ = "0.1.0"
