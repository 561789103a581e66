"""The verdict on an estimate: checks, score tests of model errors, what still holds."""
