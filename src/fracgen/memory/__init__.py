"""Memory and speed of the transformer in training: each choice of `fracgen.config.train.Trainer` is a module here."""
