"""The embedded filter's C in double: what float costs is the difference."""

from spinfilters.pipeline.estimator_entries.embedded import EmbeddedEntry


class EmbeddedDoubleEntry(EmbeddedEntry):
    """Table entry of the embedded filter in double precision."""

    name, order, real = "embedded-double", 6, "double"


ESTIMATOR = EmbeddedDoubleEntry()
