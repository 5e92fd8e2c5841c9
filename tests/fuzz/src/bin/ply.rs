#![no_main]
stereomist_fuzz::particles!("ply");
