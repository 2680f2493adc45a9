"""The data models that all packages of orthomill share. Imports nothing from the rest of the project."""
