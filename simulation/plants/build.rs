//! Compiles the logger that FMUs of version 2 call, for the feature `fmi`.

fn main() {
    println!("cargo::rerun-if-changed=src/fmu/log.c");
    #[cfg(feature = "fmi")]
    cc::Build::new()
        .file("src/fmu/log.c")
        .warnings_into_errors(true)
        .compile("luna_plants_fmu_log");
}
