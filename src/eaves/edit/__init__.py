"""The operator's table: the page of a run with a queue and tools, each change modelled again at once."""
