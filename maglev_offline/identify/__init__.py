"""The plant from its own recordings: parameters with intervals, what the samples cannot say, and a plant file."""
