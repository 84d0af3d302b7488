"""Trained policies leave the house: ONNX, a C header, safetensors, and rollouts as MCAP logs."""
