"""How messages travel: a module for each library, with a `Hub` and a `Node`."""
