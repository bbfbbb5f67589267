//! `dermatome`: the command, which is the crate `dermatome-command`.

use std::process::ExitCode;

fn main() -> ExitCode {
    dermatome_command::main()
}
