"""State recovery: gap, velocity and current between the samples, with covariances, through plant and law."""
