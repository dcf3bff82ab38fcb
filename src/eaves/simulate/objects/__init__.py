"""What stands in a made scene: ground, houses, streets, trees, furniture."""
