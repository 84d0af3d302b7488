"""From samples to transitions: construction, one-step cost, coverage, balance."""
