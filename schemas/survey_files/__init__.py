"""Files of surveyors and drones as they are found: encodings, separators, names of columns and of photographs, and which format."""
