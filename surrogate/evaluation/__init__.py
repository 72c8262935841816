"""How right the network is: errors, baselines, figures."""
