"""Classical control of the suspension: the paper's PID and LQI, and the fair baselines that the paper leaves out."""
