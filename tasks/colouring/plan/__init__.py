"""The jobs and regions that the stages which colour a surface have in common."""
