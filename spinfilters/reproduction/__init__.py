"""Tables and figures of the sources: printed, computed by this package, and bound."""
