"""From messages to samples: checks, clock, resampling, state reconstruction, the samples store."""
