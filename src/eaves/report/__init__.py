"""What people see: progress, pictures, the report."""
