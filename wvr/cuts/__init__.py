"""What cuts a ray into stretches: clips and labels."""
