"""The methods of a run with their parameters, and the published systems that are such chains."""
