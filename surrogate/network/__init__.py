"""The network: inputs, model, training, weights, prediction."""
