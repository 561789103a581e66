"""Named changes of a state that no sensor can detect."""
