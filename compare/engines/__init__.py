"""The engines, one file each; only that file imports the library it is named after."""
