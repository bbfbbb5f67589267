//! Times in files: numbers in a unit that the name of their column gives, or dates.

use crate::io::file::lines::{POINT_NEEDED, finite, has_decimal_comma};

/// How many of the units of a column of times are a second: `time` and `time[s]` 1, `time[ms]` 1000. An error states what
/// unit is needed; `None` if the name is not one of times.
pub(crate) fn time_column(name: &str) -> Option<Result<u32, &'static str>> {
    let (name, unit) = name.split_once('[').unwrap_or((name, "s"));
    if !["time", "times", "timestamp", "timestamps", "t"]
        .iter()
        .any(|known| name.trim().eq_ignore_ascii_case(known))
    {
        return None;
    }
    Some(match unit.trim_end_matches(']').trim() {
        "s" => Ok(1),
        "ms" => Ok(1000),
        "us" | "\u{b5}s" | "\u{3bc}s" => Ok(1_000_000),
        "ns" => Ok(1_000_000_000),
        _ => Err("a time in s, ms, us or ns, as time[ms]"),
    })
}

/// More seconds than this are no time in s: 1e11 s after 1970 is the year 5138, 1e11 ms is 1973.
pub(crate) const LATEST: f64 = 1e11;

/// The time of a word, in s: a number, or a date and time of ISO 8601, from 1970 on. An error states what is needed.
pub(crate) fn seconds(word: &str, per_second: u32) -> Result<f64, &'static str> {
    match finite(word).map(|number| number / f64::from(per_second)) {
        Some(time) if time.abs() <= LATEST => Ok(time),
        Some(_) => Err("a time in s; name the column `time[ms]`, `time[us]` or `time[ns]` if it is not"),
        None if has_decimal_comma(word) => Err(POINT_NEEDED),
        None => date(word).ok_or("a finite time, or a date as 2026-01-31T12:00:00.5Z"),
    }
}

/// The number of these digits, at most `most`.
fn whole(text: &str, most: i64) -> Option<i64> {
    let is_digits = !text.is_empty() && text.len() <= 4 && text.bytes().all(|b| b.is_ascii_digit());
    text.parse().ok().filter(|&n| is_digits && n <= most)
}

/// Days from 1970 on of `2026-01-31`.
pub(crate) fn days(day: &str) -> Option<i64> {
    let mut parts = day.splitn(3, '-');
    let (year, month, day) =
        (whole(parts.next()?, 9999)?, whole(parts.next()?, 12)?, whole(parts.next()?, 31)?);
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let longest = match month {
        2 => 28 + i64::from(is_leap),
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    };
    if month < 1 || !(1..=longest).contains(&day) {
        return None;
    }
    // Days of the calendar, of years that begin in March.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let before = 365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    Some(before + (153 * month + 2) / 5 + day - 1 - 719_468)
}

/// Seconds from 1970 on of `2026-01-31T12:00:00.5+01:00`; without a zone, of UTC.
fn date(word: &str) -> Option<f64> {
    let (day, time) = word.split_once(['T', 't', ' '])?;
    let days = days(day)?;
    let (time, zone) = match time.find(['+', '-']) {
        Some(at) => time.split_at(at),
        None => (time.strip_suffix(['Z', 'z']).unwrap_or(time), ""),
    };
    let zone = match zone.split_at_checked(1) {
        None => 0,
        Some((sign, zone)) => {
            let (hours, minutes) = zone.split_once(':').or(zone.split_at_checked(2))?;
            let minutes = 60 * whole(hours, 23)? + if minutes.is_empty() { 0 } else { whole(minutes, 59)? };
            if sign == "-" { -minutes } else { minutes }
        }
    };
    let mut parts = time.splitn(3, ':');
    let (hours, minutes) = (whole(parts.next()?, 24)?, whole(parts.next()?, 59)?);
    let seconds = parts.next().map_or(Some(0.0), |text| finite(text).filter(|s| (0.0..61.0).contains(s)))?;
    if hours == 24 && (minutes > 0 || seconds > 0.0) {
        return None;
    }
    let minutes = 60 * hours + minutes - zone;
    #[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
    let whole = (86_400 * days + 60 * minutes) as f64;
    Some(whole + seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_seconds_or_dates() {
        let time = seconds;
        assert_eq!(time("1500", 1000).unwrap(), 1.5);
        assert_eq!(time("0,5", 1), Err(POINT_NEEDED));
        for (name, expected) in [("t", Some(Ok(1))), ("Time [ns]", Some(Ok(1_000_000_000))), ("timer", None)]
        {
            assert_eq!(time_column(name), expected, "{name}");
        }
        assert!(time_column("time[min]").is_some_and(|unit| unit.is_err()));
        assert_eq!(time("1970-01-02T00:00:01.5Z", 1).unwrap(), 86_401.5);
        assert_eq!(time("2026-01-31 12:00:00+01:30", 1).unwrap(), 1_769_855_400.0);
        assert_eq!(time("2024-02-29T23:59:59-0100", 1000).unwrap(), 1_709_254_799.0);
        assert_eq!(time("1970-01-01T24:00:00", 1).unwrap(), 86_400.0);
        for odd in [
            "1.7e12",
            "nan",
            "2026-13-01T00:00",
            "2026-02-31T00:00",
            "2100-02-29T00:00",
            "2026-04-31T00:00",
            "2026-01-01",
            "T",
            "2026-01-01T00:00+x",
            "2026-01-01T24:59:59",
            "2026-01-01T12:00ZZ",
            "2026-01-01T12:00+01:00Z",
        ] {
            assert!(time(odd, 1).is_err(), "{odd}");
        }
    }
}
