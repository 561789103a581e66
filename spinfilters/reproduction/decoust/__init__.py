"""Tables and figures of Decoust (2008), a file each."""
