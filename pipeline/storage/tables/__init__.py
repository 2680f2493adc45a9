"""Tables on disk, and the columns in them."""
