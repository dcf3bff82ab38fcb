"""The report: the page, pictures, the notebook."""
