"""What may befall a run, and what being safe from it costs: kills, rotting stores, a starved machine."""
