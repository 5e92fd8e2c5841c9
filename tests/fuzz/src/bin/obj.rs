#![no_main]
stereomist_fuzz::mesh!("OBJ", "obj");
