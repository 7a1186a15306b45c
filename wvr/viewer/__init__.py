"""A progressive viewer that says how wrong its picture is: docs/viewer.md."""
