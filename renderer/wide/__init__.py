"""Eight values at once: formulas of plain numbers that may as well be f32x8; rows of memory, read and written eight at a time;
and what is called for one lane after the other."""
