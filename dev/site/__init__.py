"""The site of the documents, built by ``make docs``."""
