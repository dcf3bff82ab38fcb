"""The published systems, a folder each: recipe and steps. What several share stays in the stages."""
