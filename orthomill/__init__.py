"""orthomill: from overlapping photographs to a checked surface model and a blended true orthoimage."""
