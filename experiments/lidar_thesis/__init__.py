"""The point-cloud processing of Decoust (2008), chapters 3 and 4, with its names and parameters."""
