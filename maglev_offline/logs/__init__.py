"""MCAP <-> columns: reading, decoding, signal mapping, writing, surrogate logs."""
