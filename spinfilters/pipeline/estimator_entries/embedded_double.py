"""The embedded filter's C in double: what float costs is the difference."""

from spinfilters.pipeline.estimator_entries.embedded import EmbeddedEntry


class EmbeddedDoubleEntry(EmbeddedEntry):
    """See `EmbeddedEntry`."""

    name, order, real = "embedded-double", 6, "double"


ESTIMATOR = EmbeddedDoubleEntry()
