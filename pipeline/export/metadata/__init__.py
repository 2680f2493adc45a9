"""What catalogues and auditors are told of a run: STAC, ISO 19115 and ISO 19157, PROV."""
