"""maglev-offline: what logged PID data can teach a maglev suspension controller, and what it cannot."""

__version__ = "0.1.0"
