"""The commands of `harvester`: one function each, its options from its signature."""
