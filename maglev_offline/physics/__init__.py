"""The suspension: parameters, nonlinear dynamics, linearisation, disturbances. Knows nothing above it."""
