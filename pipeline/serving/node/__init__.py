"""orthomill as an engine of the NodeODM contract: routes, uploads, options by their names, and a page of its own."""
