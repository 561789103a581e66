"""Rotational dynamics of a rigid body and its mass distribution."""
