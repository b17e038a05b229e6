"""A job watched where no browser is: in the terminal, in tev, in lines."""
