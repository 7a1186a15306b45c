"""Volumes in parts: rendered brick by brick, in memory, from a store, or by the workers of a cluster."""
