"""Objects of a simulated scene: ground, houses, streets, trees, furniture."""
