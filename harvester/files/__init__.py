"""Reading and writing files, and which folders and settings around the program are trusted."""
