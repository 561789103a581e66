"""The hand-written C of a generated filter."""
