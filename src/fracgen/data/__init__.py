"""From a data set of clips to batches of latents: encoded once, read without VAE and encoders."""
