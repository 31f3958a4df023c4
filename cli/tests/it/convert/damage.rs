//! Recordings that are cut off, damaged, or none.

use super::*;

#[test]
fn a_truncated_recording_is_converted_as_far_as_it_goes() {
    let (folder, file) = recording("truncated");
    let mut whole = bytes();
    let length = whole.len();
    // A second block with a missing end.
    let second = whole[16..].to_vec();
    whole.extend_from_slice(&second[..second.len() - 9]);
    fs::write(&file, &whole).unwrap();
    for to in ["csv", "perfetto"] {
        let output = luna(&["convert", path(&file), "--to", to]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert!(text(&output.stdout).contains("6 samples"));
        let said = text(&output.stderr);
        assert!(said.contains(&format!("(at byte {length})")), "{said}");
    }
    // Damaged is another thing.
    whole[length + 20] ^= 1;
    whole.extend_from_slice(&[0; 9]);
    fs::write(&file, &whole).unwrap();
    let output = luna(&["convert", path(&file), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("damaged"),
        "{}",
        text(&output.stderr)
    );
    assert!(folder.join("run.csv").exists());
}

#[test]
fn what_lies_behind_damage_is_converted() {
    let (folder, file) = recording("damaged");
    let mut whole = bytes();
    let block = whole[16..].to_vec();
    let mut damaged = block.clone();
    damaged[40] ^= 1;
    whole.extend_from_slice(&damaged);
    whole.extend_from_slice(&block);
    fs::write(&file, &whole).unwrap();
    for to in ["csv", "perfetto"] {
        let output = luna(&["convert", path(&file), "--to", to]);
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output.stdout).contains("12 samples of 3 signals, 4 messages"));
        let said = text(&output.stderr);
        let skipped = format!("bytes skipped {}", block.len());
        assert!(
            said.contains("checksum is wrong") && said.contains(&skipped),
            "{said}"
        );
    }
    let csv = fs::read_to_string(folder.join("run.csv")).unwrap();
    assert!(csv.lines().count() > 6, "{csv}");
}

#[test]
fn what_is_no_recording_is_refused_and_nothing_is_written() {
    let (folder, file) = recording("refused");
    let other = folder.join("other.luna");
    fs::write(&other, "time,value\n0,1\n").unwrap();
    let output = luna(&["convert", path(&other), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("no recording of LUNA"),
        "{}",
        text(&output.stderr)
    );
    assert!(!folder.join("other.csv").exists());
    let output = luna(&["convert", "/no/such/file", "--to", "csv"]);
    assert_eq!(output.status.code(), Some(2));
    let before = fs::read(&file).unwrap();
    let output = luna(&["convert", path(&file), "--to", "csv", "-o", path(&file)]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(fs::read(&file).unwrap(), before);
    assert_eq!(
        luna(&["convert", path(&file)]).status.code(),
        Some(2),
        "--to is missing"
    );
    assert_eq!(
        luna(&["convert", path(&file), "--to", "png"]).status.code(),
        Some(2)
    );
}
