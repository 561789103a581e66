"""Dense model of a body from stereo pairs and its estimated motion."""
