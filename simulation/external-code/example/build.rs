//! Compiles the controller.

fn main() {
    println!("cargo::rerun-if-changed=controller");
    cc::Build::new()
        .file("controller/pid.c")
        .warnings_into_errors(true)
        .compile("controller");
}
