"""Neural surrogate of meso: database, training, evaluation, provider."""
