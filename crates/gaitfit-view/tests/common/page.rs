//! How pages are read back.
#![allow(clippy::unwrap_used)] // Test data: a panic is the report.

use roxmltree::{Document, ParsingOptions};

/// A browser forgives what an XML parser does not: every element closed, every name escaped.
pub fn parse(page: &str) -> Document<'_> {
    let options = ParsingOptions { allow_dtd: true, nodes_limit: u32::MAX, ..ParsingOptions::default() };
    Document::parse_with_options(page, options).unwrap()
}

/// What a reader sees.
pub fn text(document: &Document) -> String {
    let shown = document.descendants().filter(|n| {
        n.is_text() && !n.ancestors().any(|a| a.has_tag_name("script") || a.has_tag_name("style"))
    });
    shown.filter_map(|n| n.text()).collect::<Vec<_>>().join(" ")
}

/// Asserts that the page asks the network for nothing and forbids it too.
pub fn assert_offline(page: &str) {
    let rest = page.replace("http://www.w3.org/2000/svg", "");
    for forbidden in ["http://", "https://", "//cdn", "@import", "url(", "<link", "<iframe", "src="] {
        assert!(!rest.contains(forbidden), "{forbidden}");
    }
    let document = parse(page);
    let policy = document.descendants().find_map(|n| {
        n.attribute("http-equiv")
            .filter(|h| *h == "Content-Security-Policy")
            .and_then(|_| n.attribute("content"))
    });
    assert!(policy.unwrap().starts_with("default-src 'none'"));
}

/// Asserts that no number in the page's text or pictures is NaN or infinite.
pub fn assert_finite(page: &str) {
    let document = parse(page);
    let shown = text(&document);
    assert!(!shown.contains("NaN") && !shown.contains("inf"), "{shown}");
    let attributes = document.descendants().flat_map(|n| n.attributes().map(|a| a.value().to_string()));
    for value in attributes.filter(|v| !v.contains(' ') || v.starts_with('M')) {
        assert!(!value.contains("NaN") && !value.contains("inf"), "{value}");
    }
}

/// Asserts that a page of hostile names has the scripts of an honest one and no other, and shows names as written.
pub fn assert_harmless(page: &str, honest: &str) {
    assert_eq!(page.matches("<script").count(), honest.matches("<script").count());
    assert_eq!(page.matches("</script").count(), honest.matches("</script").count());
    assert!(!page.contains("<img") && !page.contains('\u{202e}'));
    assert!(page.chars().all(|c| c == '\n' || !c.is_control()), "a control character is in the page");
    let document = parse(page);
    assert!(document.descendants().all(|n| n.attributes().all(|a| !a.name().starts_with("on"))));
    let title = document.descendants().find(|n| n.has_tag_name("h1")).unwrap();
    assert!(title.text().unwrap().contains("<script>alert('x')</script>"), "shown as written");
    assert!(title.text().unwrap().contains("{{ 7*7 }}"), "not run as a template");
}

/// A name that tries to leave wherever it is put.
pub const HOSTILE: &str = "</style></script><script>alert('x')</script><img src=x onerror=\"a\">]]>&\u{0}\u{1b}[31m\u{7}\u{85}\u{9b}\u{202e}{{ 7*7 }}";
