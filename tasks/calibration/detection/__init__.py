"""Detection of chessboards in one photograph: corners, lattices and the homographies of their planes."""
