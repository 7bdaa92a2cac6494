//! One chart kind a file; each returns one inline SVG whose colours come from the page's style sheet.
