"""Plug-ins of Hydra that belong to fracsim; Hydra loads what lies in `hydra_plugins` whenever it starts."""
