"""eaves: from raw airborne LiDAR to valid 3D buildings."""
