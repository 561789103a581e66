"""Changes of a state that no sensor can see, by name."""
