"""Evidence: the studies that regenerate the papers' tables and charts, and the references they are judged by."""
