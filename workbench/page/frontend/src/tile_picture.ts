/** A tile as a picture that can be drawn. */

export async function tilePicture(url: string): Promise<HTMLImageElement> {
  const picture = new Image();
  picture.src = url;
  await picture.decode().catch(() => {
    throw new Error("a part of the wall could not be fetched; is the server still there?");
  });
  return picture;
}
