"""Replay buffers: the ring that agents sample from, the prefill that it may start with, and its file."""
