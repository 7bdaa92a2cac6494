//! Damage that knows little of what it damages.

use crate::Draws;

/// `file` with one to four places changed, inserted, removed or repeated, or cut off. Headers, trailers and the beginnings of
/// pages are hit more often than the rest: they say more.
pub fn bytes(file: &[u8], draws: &mut Draws) -> Vec<u8> {
    let mut out = file.to_vec();
    for _ in 0..=draws.below(4) {
        if out.is_empty() {
            break;
        }
        let length = out.len();
        let at = match draws.below(4) {
            // Formats keep their headers at the beginning and tables of contents at the end.
            0 => draws.below(length.min(256)),
            1 => length - 1 - draws.below(length.min(256)),
            // Databases have pages of such sizes.
            2 => (4096 * draws.below(length.div_ceil(4096)) + draws.below(64)).min(length - 1),
            _ => draws.below(length),
        };
        let end = (at + 1 + draws.below(64)).min(length);
        match draws.below(8) {
            0 => out[at] ^= 1 << draws.below(8),
            // Bounds of signed and unsigned bytes.
            1 => out[at] = *draws.one(&[0, 1, 0x7f, 0x80, 0xff]),
            2 => out[at] = draws.below(256) as u8,
            // Eight bytes: a whole length, offset or double.
            3 => out[at..(at + 8).min(length)].fill(*draws.one(&[0, 0xff])),
            4 => out.truncate(at),
            5 => drop(out.drain(at..end)),
            6 => {
                let part = out[at..end].to_vec();
                out.splice(at..at, part);
            }
            _ => drop(out.splice(at..at, (draws.below(1 << 20) as u32).to_le_bytes())),
        }
    }
    out
}

/// A text with one to four places changed: letters of `alphabet`, `words` instead of what stands between two of `borders`,
/// parts repeated elsewhere, parts removed, the end cut off. It need not be UTF-8 any more.
pub fn text(file: &[u8], alphabet: &[u8], words: &[&str], borders: &[u8], draws: &mut Draws) -> Vec<u8> {
    let mut out = file.to_vec();
    for _ in 0..=draws.below(4) {
        if out.is_empty() {
            out.push(b'\n');
        }
        let at = draws.below(out.len());
        match draws.below(7) {
            0 => out[at] = *draws.one(alphabet),
            1 => out.insert(at, *draws.one(alphabet)),
            2 if !words.is_empty() => {
                let is_border = |byte: &u8| borders.contains(byte);
                let start = out[at..].iter().position(is_border).map_or(at, |i| at + i + 1);
                let end = out[start..].iter().position(is_border).map_or(start, |i| start + i);
                out.splice(start..end, draws.one(words).bytes());
            }
            3 => {
                let part = out[draws.part(out.len(), 200)].to_vec();
                out.splice(at..at, part);
            }
            4 => drop(out.drain(draws.part(out.len(), 100))),
            5 => out.truncate(out.len() - draws.below(30.min(out.len()))),
            _ => out[at] ^= 1 << draws.below(8),
        }
    }
    out
}

/// A file of records: `head`, then for each record a byte that names its kind, 8 bytes of its length, little-endian, and its
/// content, as MCAP has them. One to three records are damaged inside, repeated, removed, or put elsewhere; their lengths fit.
pub fn framed(file: &[u8], head: usize, draws: &mut Draws) -> Vec<u8> {
    let (head, mut rest) = file.split_at(head.min(file.len()));
    let mut records: Vec<(u8, Vec<u8>)> = Vec::new();
    while let Some(([kind, length @ ..], after)) = rest.split_first_chunk::<9>() {
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let Some((content, next)) = after.split_at_checked(length) else { break };
        records.push((*kind, content.to_vec()));
        rest = next;
    }
    for _ in 0..=draws.below(3) {
        if records.is_empty() {
            break;
        }
        // The first records define what the others mean.
        let at = match draws.below(2) {
            0 => draws.below(records.len().min(12)),
            _ => draws.below(records.len()),
        };
        match draws.below(8) {
            0 => drop(records.remove(at)),
            1 => records.insert(draws.below(records.len()), records[at].clone()),
            2 => {
                let to = draws.below(records.len());
                records.swap(at, to);
            }
            // MCAP's kinds of records are 1 to 15.
            3 => records[at].0 = draws.below(16) as u8,
            _ => records[at].1 = bytes(&records[at].1, draws),
        }
    }
    let mut out = head.to_vec();
    for (kind, content) in &records {
        out.push(*kind);
        out.extend((content.len() as u64).to_le_bytes());
        out.extend(content);
    }
    // What follows the last whole record, such as a trailer, stays.
    out.extend(rest);
    out
}
