"""Operations on jobs, independent of HTTP: creating, changing, listing and describing them."""
