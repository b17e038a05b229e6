"""Numbers, and what is made of them: the samplers, square_to_* beside square_to_*_pdf, the pixel filters."""
