//! Inputs as every subcommand reads them, and outputs that are written together or not at all.

pub(crate) mod input;
pub(crate) mod outputs;
pub(crate) mod paths;
pub(crate) mod patterns;
pub(crate) mod pictures;
#[cfg(unix)]
pub(crate) mod signals;
/// On other systems a stopped run leaves its temporary files.
#[cfg(not(unix))]
pub(crate) mod signals {
    pub(crate) fn catch_signals(_: &dermatome::io::Outputs) {}

    pub(crate) fn stopped() -> Option<u8> {
        None
    }

    pub(crate) fn live_input() -> std::io::Result<std::io::Stdin> {
        Ok(std::io::stdin())
    }
}
