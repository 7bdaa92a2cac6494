//! Links to files beside a report.

use crate::Link;
use crate::format::clean;
use serde::Serialize;

/// Links a page shows at most.
const MAX_LINKS: usize = 100;

/// A link as the template sees it.
#[derive(Serialize)]
pub(crate) struct ShownLink {
    text: String,
    /// None if the path leads elsewhere than to a file beside the page.
    href: Option<String>,
}

/// Links whose paths stay beside the page; of others the text remains.
pub(crate) fn links(list: &[Link]) -> Vec<ShownLink> {
    let shown = |link: &Link| ShownLink {
        text: clean(if link.text.is_empty() { &link.path } else { &link.text }),
        href: beside(&link.path),
    };
    list.iter().take(MAX_LINKS).map(shown).collect()
}

/// The path as a URL reference if all its parts are plain names. A fragment (`#t=2`) may follow.
fn beside(path: &str) -> Option<String> {
    let (file, fragment) = path.split_once('#').map_or((path, None), |(f, t)| (f, Some(t)));
    // Paths come from results that others made: a link must not lead out of the folder of the page.
    let plain = |part: &str| !part.is_empty() && part != "." && part != "..";
    // A colon could begin a scheme such as `javascript:`, and browsers take a backslash for a slash.
    let is_beside = path.len() < 1000 && file.split('/').all(plain) && !file.contains(['\\', ':']);
    let encoded = |text: &str, kept: &[u8]| {
        text.bytes().fold(String::new(), |mut out, b| {
            // The unreserved characters of URLs (RFC 3986, section 2.3); all others are written by their bytes.
            if b.is_ascii_alphanumeric() || b"-._~".contains(&b) || kept.contains(&b) {
                out.push(char::from(b));
            } else {
                out.push_str(&format!("%{b:02X}"));
            }
            out
        })
    };
    is_beside.then(|| match fragment {
        Some(fragment) => format!("{}#{}", encoded(file, b"/"), encoded(fragment, b"=&")),
        None => encoded(file, b"/"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_to_files_beside_the_page_only() {
        assert_eq!(beside("seed-1/replay.html#t=2.5"), Some("seed-1/replay.html#t=2.5".into()));
        assert_eq!(beside("a b/\"é\".html"), Some("a%20b/%22%C3%A9%22.html".into()));
        for elsewhere in [
            "",
            "/etc/passwd",
            "../x",
            "a/../../x",
            "javascript:alert(1)",
            "https://x",
            "//host/x",
            "a\\b",
            ".",
        ] {
            assert_eq!(beside(elsewhere), None, "{elsewhere}");
        }
    }
}
