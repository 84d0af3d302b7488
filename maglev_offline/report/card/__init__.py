"""The dataset card: what the curated transitions are, where they came from, and what they may be used for."""
