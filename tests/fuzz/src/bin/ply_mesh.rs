#![no_main]
stereomist_fuzz::mesh!("PLY", "ply");
