"""What is inferred before a run: its start, and which noise it uses - stated, identified, adapted."""
