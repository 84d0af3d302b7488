"""DDPG and TD3 as published, over a block of seeds at once: networks, updates, training loop, evaluation."""
