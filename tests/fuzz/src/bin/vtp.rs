#![no_main]
stereomist_fuzz::particles!("vtp");
