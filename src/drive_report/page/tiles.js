
// --- The map below the drive ---

/** How much of the page's ground covers the map, so that lines are seen on it. */
const VEIL = 0.45;
const below = JSON.parse($('tiles').textContent);
const pictures = below.tiles.map(({ corners, picture }) => {
  const image = new Image();
  image.onload = draw;
  image.onerror = () => {
    $('hint').textContent = 'A tile of the map is damaged and left out.';
    $('hint').hidden = false;
  };
  image.src = picture;
  return { corners, image };
});
// Tags of it are left out; nothing in them runs or is loaded.
$('frame').append(make('p', { id: 'source', textContent: new DOMParser().parseFromString(below.source, 'text/html').body.textContent }));

drawBelow = (pen, X, Y) => {
  for (const { corners: [[x, y], [right, across], [left, down]], image } of pictures) {
    const { naturalWidth: width, naturalHeight: height } = image;
    if (!width) continue;
    pen.save();
    pen.transform((X(right) - X(x)) / width, (Y(across) - Y(y)) / width, (X(left) - X(x)) / height, (Y(down) - Y(y)) / height, X(x), Y(y));
    // Half a pixel more leaves no seam.
    const more = width / (2 * (X(right) - X(x)));
    pen.drawImage(image, 0, 0, width + more, height + more);
    pen.restore();
  }
  pen.fillStyle = colours['--panel'];
  pen.globalAlpha = VEIL;
  pen.fillRect(0, 0, map.clientWidth, map.clientHeight);
  pen.globalAlpha = 1;
  // The path is grey, as a map may be.
  strokeLine(pen, X, Y, parts.path || [], '--panel', 12);
};
