//! The stored cases: every input that once broke something.

use std::process::Command;

#[test]
fn the_stored_cases_hold() {
    let run = Command::new(env!("CARGO_BIN_EXE_fuzz")).args(["0", "1"]).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stdout));
}
