"""Request and response models of the API, as documented by OpenAPI."""
