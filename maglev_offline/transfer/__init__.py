"""Does prefill help or harm? Arms, metrics, paired statistics, and a verdict in words."""
