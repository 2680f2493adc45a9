"""Stage `projection`: orthoimages on any plane, unrolled cylinders and views of a solid surface, coloured by all that see it."""
