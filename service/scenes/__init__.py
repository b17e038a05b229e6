"""Operations on scenes, independent of HTTP: uploading, opening examples, listing, describing and deleting them."""
