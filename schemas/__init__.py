"""The words that all rooms of orthomill share. Imports nothing from the rest of the project."""
