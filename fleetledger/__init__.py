"""Front door: command line, configuration, composition root, processes."""
