//! Why a log of touches cannot be used.

use crate::calib::CalibError;
use crate::skin::TaxelId;

/// Why a log of touches cannot be used. Lines are those of [`TouchFrame::row`](crate::touches::TouchFrame::row).
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum TouchesError {
    #[error(transparent)]
    Cancelled(#[from] crate::run::Cancelled),
    #[error(transparent)]
    Calib(#[from] CalibError),
    #[error(transparent)]
    Sparse(#[from] crate::sparse::SparseError),
    #[error("line {row}: {what} is not valid; needed: {needed}")]
    InvalidFrame { row: usize, what: &'static str, needed: &'static str },
    #[error(
        "line {row}: taxel {id} has the reading {reading:e}; needed: a number from 1e-100 to 1e100, and only active taxels"
    )]
    BadReading { row: usize, id: TaxelId, reading: f64 },
    #[error("line {row}: taxel {id} comes twice; needed: every active taxel once")]
    TaxelTwice { row: usize, id: TaxelId },
    #[error(
        "line {row}: the time {time} s is before that of the line above, {earlier} s; needed: the frames of a touch in their order"
    )]
    OutOfOrder { row: usize, time: f64, earlier: f64 },
    #[error(
        "line {row}: touch {touch} goes on after another one; needed: the lines of a touch one after the other"
    )]
    Resumed { row: usize, touch: u64 },
    #[error(
        "line {row}: touch {touch} has another contact than in the line above; needed: one contact for all lines of a touch"
    )]
    SeveralContacts { row: usize, touch: u64 },
    #[error("readings in {unit:?} and a stiffness; needed: a unit of force or pressure, or no stiffness")]
    NoForce { unit: String },
    #[error("none of the {frames} frames has an active taxel that is used; needed: at least one")]
    NothingFelt { frames: usize },
    #[error("{option} is {found}; needed: {:e} to {:e}", .range[0], .range[1])]
    BadOption { option: &'static str, found: f64, range: [f64; 2] },
    #[error("line {row}: taxel {id} is not in the drawing of the skin; needed: a taxel that it has")]
    UnknownTaxel { row: usize, id: TaxelId },
    #[error(
        "the touches do not determine the outside of the skin: {detail}; needed: the normals of its taxels"
    )]
    NoOutside { detail: &'static str },
    #[error(
        "line {row}: the link {link:?} has no pose; needed: columns x,y,z,qx,qy,qz,qw, or poses of that link"
    )]
    NoPose { row: usize, link: String },
    #[error("line {row}: the time is {}; the {what} are from {} to {} s; needed: a time of them on one clock", found_time(*.found), .span[0], .span[1])]
    OffClock { row: usize, found: Option<f64>, what: &'static str, span: [f64; 2] },
    #[error(
        "line {row}: the link is {second:?}, that of lines above is {first:?}; needed: one link, or the choice of one"
    )]
    SeveralLinks { row: usize, first: String, second: String },
    #[error("no row has the link {wanted:?}, the first has {found:?}; needed: a link of the log")]
    NoLink { wanted: String, found: String },
    #[error("line {row}: taxel {id} has no reading, others have; needed: id:value for all, or ids alone")]
    PartlyRead { row: usize, id: TaxelId },
    #[error("line {row}: taxels are in the log and in a recording; needed: one of them")]
    TwoReadings { row: usize },
    #[error(
        "taxel {id} of the drawing is in the patch {:?} and in {:?}; needed: ids that differ on a link, and where links share \
         them a column `link` of the log with the one that is touched", .patches[0], .patches[1]
    )]
    SharedId { id: TaxelId, patches: [String; 2] },
    #[error(
        "the link {link:?} of the log is the name of {links} links of the skin; needed: that of one link"
    )]
    SharedLink { link: String, links: usize },
    #[error(
        "the readings have {found} columns without ids, and the drawing of the skin has {needed} taxels; needed: a column for \
         each taxel in the order of the drawing, or ids"
    )]
    Columns { found: usize, needed: usize },
    #[error(
        "line {row}: the link {link:?} is none of the robot whose joints are fitted; needed: the name of one, which carries the skin or the body"
    )]
    NoRobotLink { row: usize, link: String },
    #[error(
        "no joint moves the link {link:?} against what touches it; needed: a robot with joints between the two"
    )]
    NoMovingJoint { link: String },
    #[error(
        "the joint {joint:?} moves the link {link:?}, and has no values; needed: the values of every joint between the link and what touches it"
    )]
    NoJointValues { joint: String, link: String },
    #[error("frame {frame} of the readings is at {time} s{}; needed: the times of one trial, which ascend", after(*.last))]
    ReadingTime { frame: usize, time: f64, last: Option<f64> },
    #[error("line {row}: no taxels; needed: a column `taxels`, or a recording of the readings")]
    NoReadings { row: usize },
    #[error("touches are up to {spread:.0} m from their middle; needed: lengths in m")]
    Lengths { spread: f64 },
    #[error(
        "line {row}: the radius of the body is {radius} m, and all touches are within {spread:.3} m of their middle; needed: the \
         radius in m"
    )]
    Radius { row: usize, radius: f64, spread: f64 },
    #[error(
        "the readings differ by {noise:.3e} from what spheres of these radii give, of usually {typical:.3e}; needed: the radius of \
         the body in m, the poses of the frames, and readings that grow with the depth of the press"
    )]
    Profile { noise: f64, typical: f64 },
    #[error(
        "{left_out} of {of} {what} give no contact; needed: the touches of one skin, in one frame, with the ids of its taxels"
    )]
    MostLeftOut { what: &'static str, left_out: usize, of: usize },
    #[error(
        "line {row}: the time {time} s is before {earlier} s, that of a line above, and poses or readings are found by it; needed: the log of one run of the clock"
    )]
    ClockRestarts { row: usize, time: f64, earlier: f64 },
    #[error("taxel {id} has two columns of the readings; needed: one column for each taxel")]
    ColumnTwice { id: TaxelId },
    #[error(
        "the channel {channel:?} of the readings does not measure touches; needed: one of force, pressure, charge or counts"
    )]
    NotOfTouch { channel: String },
    #[error(
        "{active} of {taxels} taxels are above the threshold of {threshold:.3e} in most frames of the readings; needed: readings \
         that are 0 where nothing touches, or a larger threshold"
    )]
    AlwaysActive { active: usize, taxels: usize, threshold: f64 },
    #[error(
        "the link {link:?} of the log is none of the links of the skin that have patches: {}; needed: one of these", names.join(", ")
    )]
    UnknownLink { link: String, names: Vec<String> },
    #[error(
        "taxel {id} is to be left out, but neither the log nor the drawing has it; needed: ids of their taxels"
    )]
    UnknownLeftOut { id: TaxelId },
}

fn after(last: Option<f64>) -> String {
    last.map_or_else(String::new, |last| format!(", after one at {last} s"))
}

fn found_time(time: Option<f64>) -> String {
    time.map_or_else(|| "missing".to_owned(), |time| format!("{time} s"))
}
