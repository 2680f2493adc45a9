"""Heights from vertical line locus: blocks of nodes, the surface that they make, and what people take away of them."""
